"""Files that paths, estimates and links are kept in, ours and others'."""
