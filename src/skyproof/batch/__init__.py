"""Many items of work, each done once: in processes of this machine, or on the nodes of a Ray cluster.

`run` is the one door. What an item leaves is a folder that appears whole or not at all, so that whoever is killed, and
whenever, loses what was under way and nothing else.
"""

from skyproof.batch.item import Ended, Item, Task, Work
from skyproof.batch.processes import Processes
from skyproof.batch.run import Runner, run
from skyproof.batch.store import ITEMS, Store

__all__ = ["ITEMS", "Ended", "Item", "Processes", "Runner", "Store", "Task", "Work", "run"]
