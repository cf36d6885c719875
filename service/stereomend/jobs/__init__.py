"""Worker processes and the supervisor that hands refinements to them."""
