"""Drawing RGB-D frames: the two backends of `robosim.camera.cameras`, and the light baked into what they draw."""
