"""Pictures and videos of episodes, buildings and radio."""
