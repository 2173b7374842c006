"""Buildings made from floor plans: outline, walls, floor and ceiling as meshes, and where a robot can stand."""
