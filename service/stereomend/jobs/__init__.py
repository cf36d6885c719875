"""Worker processes, the pool that hands refinements to them, and durable jobs."""
