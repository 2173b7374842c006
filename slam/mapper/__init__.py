"""The learned mapper: what it is shown, its network, training, scores and files."""
