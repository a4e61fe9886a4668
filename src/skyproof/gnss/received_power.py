"""Least power on the ground of the signals that every receiver is made for, by the systems' interface documents."""

from typing import Final

__all__ = ["LEAST_RECEIVED_DBW"]

LEAST_RECEIVED_DBW: Final = {
    ("G", "L1", "CA"): -158.5,
    ("J", "L1", "CA"): -158.5,
    ("E", "E1", "B"): -160.25,
    ("E", "E1", "C"): -160.25,
    ("C", "B1", "2I"): -163.0,
    ("R", "G1", "CA"): -161.0,
}
"""Least power that an antenna of 0 dBi receives of a kind that every receiver is made for.

IS-GPS-200N, 6.3.1; IS-QZSS-PNT; Galileo OS SIS ICD 2.1 (half of E1's for each part); BDS-SIS-ICD-B1I-3.0; GLONASS ICD
5.1.
"""
