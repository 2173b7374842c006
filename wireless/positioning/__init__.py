"""Where radios are, from the paths between them."""
