"""One script per peer; each runs in its own interpreter and knows nothing of gpusim."""
