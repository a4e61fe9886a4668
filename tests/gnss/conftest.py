"""What several tests of this room need: the independent program's truth, and real messages of a receiver."""

import csv
from pathlib import Path

import numpy as np
import pytest


@pytest.fixture(scope="session")
def authentic_rows(shared_data: Path) -> dict[str, np.ndarray]:
    """Read the true signals' columns of truth.csv of the rendered pair, made by a program independent of ours."""
    with open(shared_data / "rf" / "meaconing-pair" / "truth.csv", encoding="ascii") as lines:
        rows = [row for row in csv.DictReader(lines) if row["label"] == "authentic"]
    names = {"receiver": str, "prn": int} | dict.fromkeys(
        (
            "tow_s",
            "receiver_elapsed_s",
            "az_deg",
            "el_deg",
            "range_m",
            "code_delay_s",
            "carrier_delay_s",
            "doppler_hz",
            "phase_cycles",
        ),
        float,
    )
    return {name: np.array([kind(row[name]) for row in rows]) for name, kind in names.items()}
