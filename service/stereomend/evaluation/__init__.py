"""Score raw and refined disparity maps on public datasets, as in the tables of the paper."""
