"""Networks of the learned mapper and the learned pose: inputs, layers, files, scores."""
