"""Test whether an effect is there whichever few of the data are left out.

Where errors are those of few data, as reflections are those of some satellites, what all the others show is no effect
of the errors: the largest p-value without any few of them is no smaller than that without those that err.
"""

from collections.abc import Callable, Iterable, Iterator, Sequence
from itertools import chain, combinations
from typing import TypeVar

__all__ = ["largest_p_value_without"]

T = TypeVar("T")


def largest_p_value_without(
    items: Sequence[T],
    p_values: Callable[[Iterator[tuple[T, ...]]], Iterable[float]],
    *,
    counts: Sequence[int] = (2,),
    least: int,
    enough: float = 1.0,
) -> float:
    """Return the largest of a test's p-values without any two of the items; 1 if fewer than `least` would remain.

    Parameters
    ----------
    p_values : of the test without each of the sets of items that it is given, in their order, one by one or at once.
    counts : how many are left out: of any of these numbers.
    enough : a p-value from which on the answer does not matter: no further ones are asked for.
    """
    if len(items) < least + max(counts):
        return 1.0
    largest = 0.0
    for p_value in p_values(chain.from_iterable(combinations(items, count) for count in counts)):
        largest = max(largest, float(p_value))
        if largest >= enough:
            break
    return largest
