"""What is typed reaches the use cases."""

import shlex
from pathlib import Path

from tests.cli.use_cases import PROTECT, App

from skyproof import cli

ANTENNAS = shlex.split(
    "--nav b.22n --imu imu.csv --platform p.toml --false-alarm-probability-per-hour 1e-4 --antenna-distance-m 60 "
    "--antenna-distance-sigma-m 0.5 --antenna-separation-m 2.5"
)
STRETCH = shlex.split("--tracking vector --doppler-max-hz 9e3 --place-deg 57.7 11.9 --start-s 27 --duration-s 33")


def test_options_reach_the_use_case_and_missing_ones_are_none(app: App) -> None:
    cli.main([*PROTECT, *ANTENNAS, *STRETCH, "--position-format", "degrees-minutes", "--overwrite"])
    cli.main(PROTECT)
    cli.main(["receive", "rx1.bin", "--out", "d", "--nav", "b.22n"])
    cli.main(["receive", "rx1.bin", "--out", "d", *STRETCH, "--overwrite"])
    cli.main(["init", "rx1.bin", "rx2.obs"])
    cli.main(["init", "rx1.bin", "--out", "p.toml", "--overwrite"])
    cli.main(["protect", "--platform", "p.toml", "--out", "d"])
    cli.main(["verify", "d", "--inputs-in", "e"])
    cli.main(["fleet", "c.csv", "--out", "d", "--workers", "3"])
    cli.main(["fleet", "c.csv", "--out", "d", "--ray", "auto", "--overwrite"])
    cli.main(["demo", "--out", "there", "--overwrite"])
    cli.main(
        [
            "simulate",
            "spin",
            "--out",
            "d",
            "--seed",
            "7",
            "--duration-s",
            "5",
            "--depth",
            "samples",
            "--format",
            "raw",
            "--overwrite",
        ]
    )
    cli.main(["simulate", "s.toml", "--out", "d"])
    stretch = ("tracking", "doppler_max_hz", "place_deg", "start_s", "duration_s")
    antennas = ("antenna_distance_m", "antenna_distance_sigma_m", "antenna_separation_m")
    settings = ("false_alarm_probability_per_hour", *antennas, *stretch, "position_format")
    stated = (1e-4, 60.0, 0.5, 2.5, "vector", 9e3, (57.7, 11.9), 27.0, 33.0, "degrees-minutes")
    assert app.calls == [
        (
            "protect",
            [Path("rx1.bin"), Path("rx2.bin")],
            {
                "nav": Path("b.22n"),
                "imu": Path("imu.csv"),
                "platform": Path("p.toml"),
                "out": Path("result"),
                "overwrite": True,
                **dict(zip(settings, stated, strict=True)),
            },
        ),
        (
            "protect",
            [Path("rx1.bin"), Path("rx2.bin")],
            {
                "nav": None,
                "imu": None,
                "platform": None,
                "out": Path("result"),
                "overwrite": False,
                **dict.fromkeys(settings),
            },
        ),
        (
            "receive",
            [Path("rx1.bin")],
            {"out": Path("d"), "nav": Path("b.22n"), "overwrite": False, **dict.fromkeys(stretch)},
        ),
        (
            "receive",
            [Path("rx1.bin")],
            {
                "out": Path("d"),
                "nav": None,
                "overwrite": True,
                **dict(zip(stretch, ("vector", 9e3, (57.7, 11.9), 27.0, 33.0), strict=True)),
            },
        ),
        ("init", [Path("rx1.bin"), Path("rx2.obs")], {"out": Path("platform.toml"), "overwrite": False}),
        ("init", [Path("rx1.bin")], {"out": Path("p.toml"), "overwrite": True}),
        (
            "protect",
            [],
            {
                "nav": None,
                "imu": None,
                "platform": Path("p.toml"),
                "out": Path("d"),
                "overwrite": False,
                **dict.fromkeys(settings),
            },
        ),
        ("verify", Path("d"), {"inputs_in": Path("e")}),
        ("fleet", Path("c.csv"), {"out": Path("d"), "workers": 3, "ray": None, "overwrite": False}),
        ("fleet", Path("c.csv"), {"out": Path("d"), "workers": None, "ray": "auto", "overwrite": True}),
        ("demo", Path("there"), {"overwrite": True}),
        (
            "simulate",
            "spin",
            {
                "out": Path("d"),
                "seed": 7,
                "duration_s": 5.0,
                "depth": "samples",
                "container": "raw",
                "log": None,
                "plot": False,
                "overwrite": True,
            },
        ),
        (
            "simulate",
            "s.toml",
            {
                "out": Path("d"),
                "seed": None,
                "duration_s": None,
                "depth": "all",
                "container": None,
                "log": None,
                "plot": False,
                "overwrite": False,
            },
        ),
    ]
