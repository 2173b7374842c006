"""The network of the learned mapper: inputs, layers, files, scores."""
