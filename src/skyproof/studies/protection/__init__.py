"""The protection matrix: every ready-made scene with every equipment through the whole job, held against the truth."""

from skyproof.studies.protection.matrix import STUDIES

__all__ = ["STUDIES"]
