"""How pictures of the gallery are saved."""

import matplotlib as mpl


def trimmed(gallery_conf: dict, name: str) -> None:
    """Save figures with all that belongs to them, legends next to the axes too."""
    mpl.rcParams["savefig.bbox"] = "tight"
    mpl.rcParams["savefig.dpi"] = 110
