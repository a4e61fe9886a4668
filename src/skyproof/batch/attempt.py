"""One item done, here and now, whatever called for it."""

import os
from typing import Final

from skyproof.batch.item import Ended, Task
from skyproof.batch.store import Store
from skyproof.errors import SkyproofError

__all__ = ["ONE_THREAD", "attempt"]

ONE_THREAD: Final = {
    name: "1"
    for name in (
        "SKYPROOF_THREADS",
        "NUMBA_NUM_THREADS",
        "OMP_NUM_THREADS",
        "OPENBLAS_NUM_THREADS",
        "MKL_NUM_THREADS",
        "VECLIB_MAXIMUM_THREADS",
    )
}
"""Environment of whoever does items: many work side by side, and how sums are split among threads changes their last
digits."""


def attempt(task: Task) -> Ended:
    """Do the work in a folder that becomes the item's if it ends well; an error is how the item ended."""
    folder_before = os.getcwd()
    try:
        with Store(task.store).filling(task.item) as folder:
            task.work(task.item.given, folder)
    except SkyproofError as error:
        return Ended(key=task.item.key, error=str(error))
    except Exception as error:
        return Ended(
            key=task.item.key,
            error=f"unexpected {type(error).__name__}: {' '.join(str(error).split())}. This is a fault of skyproof, "
            "not of the input",
        )
    finally:
        os.chdir(folder_before)
    return Ended(key=task.item.key)
