"""Kernels: functions that Numba compiles, where their machine code is kept from run to run, and how many threads work.

It is read where setup left it, beside the source, also where nothing may be written; what was not compiled there is
kept in the user's own cache folder ($NUMBA_CACHE_DIR, if set, comes before both), and where that cannot be written
either, it is compiled again in each run. Numba's own caching refuses all work where it may not write, and does not read
what it may not write. What is compiled while somebody waits goes to the log, once that takes seconds.
"""

import logging
import os
import time
from collections.abc import Callable
from pathlib import Path
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

__all__ = [
    "LOG",
    "compiled",
    "count_threads",
    "explain_not_kept",
    "is_kept",
    "kernels_in",
    "on_compiled",
    "writable_folder",
]

LOG: Final = logging.getLogger("skyproof")
"""For what a person waits for and no one asked about: standard error, unless it is turned elsewhere."""
SILENT_S: Final = 3.0
"""Of compiling, before it is reported; then every `EVERY_S`."""
EVERY_S: Final = 10.0
_KERNELS: dict[str, Any] = {}


def count_threads() -> int:
    """Count the threads that a process starts for one job.

    As many as the cores that it may use, or as $SKYPROOF_THREADS gives, where many processes share the cores. What they
    compute does not depend on it.
    """
    if (asked := os.environ.get("SKYPROOF_THREADS", "")).isdecimal():
        return max(int(asked), 1)
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def compiled(function: Callable[..., Any] | None = None, **options: Any) -> Any:
    """Compile a function to a kernel without a lock: `@compiled` or `@compiled(fastmath=...)`.

    options : of `numba.njit`.
    """
    if function is None:
        return lambda function: compiled(function, **options)
    kernel = numba.njit(nogil=True, **options)(function)
    kernel._cache = _Cache(function)
    _KERNELS[kernel._cache.name] = kernel
    return kernel


def kernels_in(module: str) -> dict[str, Any]:
    """Return the kernels of a module that is imported, by their full names."""
    return {name: kernel for name, kernel in _KERNELS.items() if kernel._cache.module == module}


def is_kept(kernel: Any) -> bool:
    """Return whether machine code for this processor and this source lies ready, of one signature at least."""
    if not isinstance(kernel._cache, _Cache) or getattr(numba.config, "DISABLE_JIT", False):
        return True
    return bool(kernel._cache.is_kept(kernel.targetctx.codegen().magic_tuple()))


def writable_folder(kernel: Any) -> Path | None:
    """Return where its machine code would be kept; None if no place can be written."""
    folder = kernel._cache.writable_folder()
    return None if folder is None else Path(folder)


def on_compiled(listener: Callable[[str], None]) -> None:
    """Register `listener` for the full name of each kernel that this process compiles from now on."""
    _ACCOUNT.listeners.append(listener)


class _Account:
    """What this process compiles, for how long, and when it was reported last. Kernels that call others nest."""

    def __init__(self) -> None:
        self.listeners: list[Callable[[str], None]] = []
        self._open: list[str] = []
        self._since_s = self._spent_s = 0.0
        self._count = 0
        self._explained = False
        self._report_s = SILENT_S

    def begin(self, name: str) -> None:
        now_s = time.monotonic()
        if not self._open:
            self._since_s = now_s
        self._open.append(name)

    def end(self, name: str, lost_to: str) -> None:
        """Note the end of a kernel's compilation.

        lost_to : the places that could not keep it, as text; empty if it is kept.
        """
        now_s = time.monotonic()
        if name in self._open:  # what failed to compile has no end
            del self._open[self._open.index(name) :]
        self._count += 1
        for listener in self.listeners:
            listener(name)
        spent_s = self._spent_s + now_s - self._since_s
        if not self._open:
            self._spent_s = spent_s
        if spent_s >= self._report_s:
            self._report_s = spent_s + EVERY_S
            LOG.warning("kernels compiled: %d, in %.0f s so far%s", self._count, spent_s, self.explain(lost_to))

    def explain(self, places: str) -> str:
        """Return why kernels are compiled again in each run, the first time; nothing if they are not."""
        if not places or self._explained:
            return ""
        self._explained = True
        return _not_kept_words(places)


_ACCOUNT: Final = _Account()


def explain_not_kept(kernel: Any) -> str:
    """Return why a kernel is compiled again in each run, for a sentence that says what that costs; once a process."""
    return _ACCOUNT.explain(kernel._cache.places)


def _not_kept_words(places: str) -> str:
    """Return why kernels are compiled again in each run."""
    return (
        f", in this process only, for {places} cannot be written; set NUMBA_CACHE_DIR to a folder that can be, and the "
        "next run need not wait"
    )


class _Unwritten:
    """A place that need not be writable to be read."""

    @classmethod
    def from_function(cls, py_func: Callable[..., Any], py_file: str) -> Any:
        return cls(py_func, py_file)  # type: ignore[call-arg]


class _BesideSource(_Unwritten, InTreeCacheLocator):
    pass


class _OfUser(_Unwritten, UserWideCacheLocator):
    pass


def _cache_in(locator: type) -> type:
    """Build Numba's cache of a function's machine code in the one place that `locator` knows."""
    places = type("_Impl", (CompileResultCacheImpl,), {"_locator_classes": [locator]})
    return type("_Kept", (FunctionCache,), {"_impl_class": places})


_PLACES: Final = tuple(map(_cache_in, (UserProvidedCacheLocator, _BesideSource, _OfUser)))


class _Cache(NullCache):
    """Loads machine code from the first place that has it, and saves it to the first that can be written."""

    def __init__(self, function: Callable[..., Any]) -> None:
        self.module, self.name = function.__module__, f"{function.__module__}.{function.__qualname__}"
        self._kept = []
        for place in _PLACES:
            try:
                self._kept.append(place(function))
            except (OSError, RuntimeError):  # no such place, or the source is no file
                continue

    @property
    def cache_path(self) -> str | None:
        return self._kept[0].cache_path if self._kept else None

    def is_kept(self, machine: Any) -> bool:
        """Test whether there is machine code of any signature for a machine, as Numba names it."""
        for kept in self._kept:
            try:
                index = kept._cache_file._load_index()
            except OSError:
                continue
            if any(key[1] == machine for key in index):
                return True
        return False

    def writable_folder(self) -> str | None:
        """Return the first place that takes a file."""
        for kept in self._kept:
            try:
                kept._impl.locator.ensure_cache_path()
            except OSError:
                continue
            return str(kept.cache_path)
        return None

    @property
    def places(self) -> str:
        """Name all places."""
        return " and ".join(str(kept.cache_path) for kept in self._kept) or "nothing"

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        for kept in self._kept:
            try:
                found = kept.load_overload(sig, target_context)
            except OSError:
                continue
            if found is not None:
                return found
        _ACCOUNT.begin(self.name)
        return None

    def save_overload(self, sig: Any, cres: Any) -> None:
        for kept in self._kept:
            try:
                kept.save_overload(sig, cres)
            except OSError:
                continue
            _ACCOUNT.end(self.name, "")
            return
        _ACCOUNT.end(self.name, self.places)

    def flush(self) -> None:
        for kept in self._kept:
            kept.flush()
