"""Length of a scale bar."""

#: Lengths to choose from [m].
BARS_M = (0.1, 0.2, 0.5, 1, 2, 5, 10, 20, 50, 100, 200, 500)


def bar_m(extent_m: float) -> float:
    """The longest round length of at most three tenths of what is shown [m]."""
    return max((bar for bar in BARS_M if bar <= 0.3 * extent_m), default=BARS_M[0])
