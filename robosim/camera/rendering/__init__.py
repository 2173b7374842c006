"""Drawing RGB-D frames: the two backends of `robosim.camera.camera`, and the light baked into what they draw."""
