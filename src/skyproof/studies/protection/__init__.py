"""The whole job through samples, held against the truth: the protection matrix, which has every ready-made scene with
every equipment, and hours of sky without an attack.
"""

from skyproof.studies.protection import clean, matrix

__all__ = ["STUDIES"]

STUDIES = (*matrix.STUDIES, clean.STUDY)
