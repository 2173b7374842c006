"""Number of threads that compute a network: the order of sums does not depend on the machine.

A convolution that is split over threads sums in another order, and the last bits of its result differ. Over a thousand
decisions this changes the trajectory. The networks here are too small to gain from a second thread.
"""

from collections.abc import Iterator
from contextlib import contextmanager

import torch


@contextmanager
def torch_threads(count: int = 1) -> Iterator[None]:
    """Compute with so many threads inside the block, and as before after it; half a microsecond."""
    before = torch.get_num_threads()
    torch.set_num_threads(count)
    try:
        yield
    finally:
        torch.set_num_threads(before)
