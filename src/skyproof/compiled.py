"""Kernels: functions that Numba compiles, where their machine code is kept from run to run, and how many threads work.

It is read where setup left it, beside the source, also where nothing may be written; what was not compiled there is
kept in the user's own cache folder ($NUMBA_CACHE_DIR, if set, comes before both), and where that cannot be written
either, it is compiled in each run anew. Numba's own caching refuses all work where it may not write, and does not read
what it may not write.
"""

import os
from collections.abc import Callable
from typing import Any, Final

import numba
from numba.core.caching import (
    CompileResultCacheImpl,
    FunctionCache,
    InTreeCacheLocator,
    NullCache,
    UserProvidedCacheLocator,
    UserWideCacheLocator,
)

__all__ = ["compiled", "threads"]


def threads() -> int:
    """How many threads a process of ours starts for one job: as many as the cores that it may use, or as
    $SKYPROOF_THREADS says, where many processes share the cores. What they compute does not depend on it.
    """
    if (asked := os.environ.get("SKYPROOF_THREADS", "")).isdecimal():
        return max(int(asked), 1)
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def compiled(function: Callable[..., Any] | None = None, **options: Any) -> Any:
    """Decorator `@compiled` or `@compiled(fastmath=...)`: a kernel that holds no lock while it runs.

    options : of `numba.njit`.
    """
    if function is None:
        return lambda function: compiled(function, **options)
    kernel = numba.njit(nogil=True, **options)(function)
    kernel._cache = _Cache(function)
    return kernel


class _Unwritten:
    """A place that need not be writable to be read."""

    @classmethod
    def from_function(cls, py_func: Callable[..., Any], py_file: str) -> Any:
        return cls(py_func, py_file)  # type: ignore[call-arg]


class _BesideSource(_Unwritten, InTreeCacheLocator):
    pass


class _OfUser(_Unwritten, UserWideCacheLocator):
    pass


def _kept_by(locator: type) -> type:
    """Numba's cache of a function's machine code, in the one place that `locator` knows."""
    places = type("_Impl", (CompileResultCacheImpl,), {"_locator_classes": [locator]})
    return type("_Kept", (FunctionCache,), {"_impl_class": places})


_PLACES: Final = tuple(map(_kept_by, (UserProvidedCacheLocator, _BesideSource, _OfUser)))


class _Cache(NullCache):
    """Loads machine code from the first place that has it, and saves it to the first that can be written."""

    def __init__(self, function: Callable[..., Any]) -> None:
        self._kept = []
        for place in _PLACES:
            try:
                self._kept.append(place(function))
            except (OSError, RuntimeError):  # no such place, or the source is no file
                continue

    @property
    def cache_path(self) -> str | None:
        return self._kept[0].cache_path if self._kept else None

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        for kept in self._kept:
            try:
                found = kept.load_overload(sig, target_context)
            except OSError:
                continue
            if found is not None:
                return found
        return None

    def save_overload(self, sig: Any, cres: Any) -> None:
        for kept in self._kept:
            try:
                kept.save_overload(sig, cres)
            except OSError:
                continue
            return

    def flush(self) -> None:
        for kept in self._kept:
            kept.flush()
