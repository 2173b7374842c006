"""The RGB-D camera: model, rendering, depth noise, and finding the target in a picture."""
