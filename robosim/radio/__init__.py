"""The radio link of an episode: scene, transmitters, receivers, measurement, link state."""
