"""Draws one decision of an episode from its log: the picture of the README, from the episode of `make demo`.

python scripts/demo_picture.py out/demo --step 160 --out assets/episode.png
"""

import argparse
from itertools import islice
from pathlib import Path

from PIL import Image

from robosim.recording.episode_file import read_episode
from robosim.recording.replay import picture_of


def main() -> None:
    """Read the options and write the picture."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("episode", type=Path, help="folder of `robosim episode`")
    parser.add_argument("--step", type=int, default=160, help="decision to draw")
    parser.add_argument("--out", type=Path, default=Path("assets/episode.png"))
    options = parser.parse_args()
    episode = read_episode(options.episode)
    picture = picture_of(episode)
    frames = (picture.draw(step) for step in episode.steps())
    *_, last = islice(frames, options.step + 1)
    Image.fromarray(last).save(options.out, optimize=True)


if __name__ == "__main__":
    main()
