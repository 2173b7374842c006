"""File formats of paths, estimates and links, of this project and of others."""
