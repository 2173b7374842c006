"""Lists that grow while views are followed: views, edges, visits, and the trail of one view through triangles."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from robosim.support.compiled import compiled
from wireless.geometry.array_growth import longer
from wireless.geometry.array_types import Point


class ViewList(NamedTuple):
    """Views so far; see `wireless.geometry.visibility.Visibility`."""

    image: Float[np.ndarray, "b 2"]
    chain: Int[np.ndarray, "b 5"]
    begin: Int[np.ndarray, "b 2"]
    """Triangle that each view begins in, and the side that it enters by; -1 for all of the triangle."""
    sector: Float[np.ndarray, "b 4"]
    """Sector of each view where it begins."""
    window_span: Int[np.ndarray, "b 2"]
    rise_m: Float[np.ndarray, " b"]


class EdgeList(NamedTuple):
    """Edges so far; see `wireless.geometry.visibility.Visibility`."""

    hit: Int[np.ndarray, "e 2"]
    seen_range: Float[np.ndarray, "e 2"]
    """Visible range of each edge."""
    stamp: Int[np.ndarray, " c"]
    """The view that each corner was found in last."""


class VisitList(NamedTuple):
    """Visits so far; see `wireless.geometry.visibility.Visibility`."""

    last: Int[np.ndarray, " t"]
    visit: Int[np.ndarray, "v 3"]
    sector: Float[np.ndarray, "v 4"]


class Trail(NamedTuple):
    """Triangles that one view passes, and walls that it meets."""

    step: Int[np.ndarray, "n 2"]
    """Triangles, and the sides that they are entered by; -1 where the view begins with all of a triangle."""
    sector: Float[np.ndarray, "n 4"]
    """Sector in view there."""
    hit: Int[np.ndarray, "m 2"]
    """Steps at which walls are met, and sides of their triangles."""
    bounds: Float[np.ndarray, "m 4"]
    """Range of each wall in view."""


class Stack(NamedTuple):
    """Room for triangles that are yet to be passed."""

    place: Int[np.ndarray, "k 2"]
    sector: Float[np.ndarray, "k 4"]
    last_sector: Float[np.ndarray, "4"]


@compiled
def new_views(source: Point) -> ViewList:
    """A list of views with the source as its only one."""
    begin, window_span = np.full((64, 2), -1), np.zeros((64, 2), np.int64)
    views = ViewList(
        np.empty((64, 2)), np.zeros((64, 5), np.int64), begin, np.zeros((64, 4)), window_span, np.zeros(64)
    )
    views.image[0], views.chain[0, :2] = source[:2], -1
    return views


@compiled
def more_views(views: ViewList) -> ViewList:
    """Return a copy with twice as much room."""
    image, chain, begin = longer(views.image), longer(views.chain), longer(views.begin)
    return ViewList(
        image, chain, begin, longer(views.sector), longer(views.window_span), longer(views.rise_m)
    )


@compiled
def new_trail(n: int) -> tuple[Trail, Stack]:
    """Room for so many steps, walls met and triangles that are yet to be passed."""
    step, hit, place = np.empty((n, 2), np.int64), np.empty((n, 2), np.int64), np.empty((n, 2), np.int64)
    trail = Trail(step, np.empty((n, 4)), hit, np.empty((n, 4)))
    return trail, Stack(place, np.empty((n, 4)), np.empty(4))
