"""What the trials of the service are made of; each script beside this folder runs one of them."""
