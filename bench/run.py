"""Speed and worth, measured on this machine: `make bench`, or `python bench/run.py kernel sets` for some.

Every figure is the median of several runs with their range, beside a peer, a plain version or a limit measured in the
same run. A figure without the machine and its load says nothing, so they come first.
"""

import sys
from time import perf_counter

import accuracy
import acquisition
import antennas
import arms
import array_snapshots
import arrays
import clean_grids
import clean_skies
import deciding
import drawn
import fleet
import grids
import house
import kernel
import log_reading
import many_receivers
import memory
import metadata
import methods
import nulls
import overlaps
import pairs
import position
import protection
import quality
import reading
import real_code
import rinex
import sets
import snapshots
import sqm_roc
import startup
import vector
import vector_drawn
import vector_figures
import vector_inertia
import vector_limits
import vector_takeovers
from timing import machine

import receiver
import simulator

BENCHES = {
    "kernel": kernel,
    "acquisition": acquisition,
    "sets": sets,
    "simulator": simulator,
    "accuracy": accuracy,
    "deciding": deciding,
    "methods": methods,
    "protection": protection,
    "quality": quality,
    "overlaps": overlaps,
    "receiver": receiver,
    "reading": reading,
    "metadata": metadata,
    "rinex": rinex,
    "logs": log_reading,
    "position": position,
    "pairs": pairs,
    "grids": grids,
    "many-receivers": many_receivers,
    "clean-grids": clean_grids,
    "clean-skies": clean_skies,
    "vector": vector,
    "vector-inertia": vector_inertia,
    "vector-limits": vector_limits,
    "vector-drawn": vector_drawn,
    "vector-figures": vector_figures,
    "vector-takeovers": vector_takeovers,
    "sqm-roc": sqm_roc,
    "startup": startup,
    "fleet": fleet,
    "drawn": drawn,
    "arrays": arrays,
    "antennas": antennas,
    "arms": arms,
    "snapshots": snapshots,
    "nulls": nulls,
    "array-snapshots": array_snapshots,
    "real-code": real_code,
    "memory": memory,
    "house": house,
}


def main(names: list[str]) -> None:
    unknown = [name for name in names if name not in BENCHES]
    if unknown:
        raise SystemExit(f"no bench named {', '.join(unknown)}; there are {', '.join(BENCHES)}")
    begin = perf_counter()
    print(machine())
    for name in names or BENCHES:
        for text in BENCHES[name].report():
            print(text, flush=True)
    print(f"{perf_counter() - begin:.0f} s in all")


if __name__ == "__main__":
    main(sys.argv[1:])
