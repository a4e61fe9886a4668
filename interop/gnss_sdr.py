"""gnss-sdr: a receiver for comparison. Found on the PATH, configured by the template below."""

import re
import resource
import shutil
import subprocess
from dataclasses import dataclass
from pathlib import Path
from string import Template

import numpy as np

from skyproof.gnss.frames import ecef_from_geodetic
from skyproof.records import Samples

__all__ = ["CURE", "NAME", "Received", "find", "receive", "write_as_bytes"]

NAME = "gnss-sdr"
CURE = "on Debian: apt-get install gnss-sdr"
CHANNELS = 16
BLOCK_S = 1.0

# Its documentation's usual values, but for the pull-in by a frequency loop (without it weak signals take tens of
# seconds to lock), four dwells of the search, and measurements at 5 Hz as ours.
CONFIGURATION = Template("""[GNSS-SDR]
GNSS-SDR.internal_fs_sps=$rate
SignalSource.implementation=File_Signal_Source
SignalSource.filename=$samples
SignalSource.item_type=ibyte
SignalSource.sampling_frequency=$rate
SignalSource.samples=0
SignalSource.repeat=false
SignalSource.enable_throttle_control=false
SignalConditioner.implementation=Signal_Conditioner
DataTypeAdapter.implementation=Ibyte_To_Complex
InputFilter.implementation=Pass_Through
InputFilter.item_type=gr_complex
Resampler.implementation=Pass_Through
Resampler.item_type=gr_complex
Channels_1C.count=$channels
Channels.in_acquisition=$channels
Acquisition_1C.implementation=GPS_L1_CA_PCPS_Acquisition
Acquisition_1C.item_type=gr_complex
Acquisition_1C.coherent_integration_time_ms=1
Acquisition_1C.max_dwells=4
Acquisition_1C.pfa=0.001
Acquisition_1C.doppler_max=7000
Acquisition_1C.doppler_step=125
Acquisition_1C.blocking=true
Tracking_1C.implementation=GPS_L1_CA_DLL_PLL_Tracking
Tracking_1C.item_type=gr_complex
Tracking_1C.pll_bw_hz=20
Tracking_1C.dll_bw_hz=1.5
Tracking_1C.early_late_space_chips=0.5
Tracking_1C.enable_fll_pull_in=true
Tracking_1C.fll_bw_hz=10
Tracking_1C.pull_in_time_s=1
TelemetryDecoder_1C.implementation=GPS_L1_CA_Telemetry_Decoder
Observables.implementation=Hybrid_Observables
PVT.implementation=RTKLIB_PVT
PVT.positioning_mode=Single
PVT.output_rate_ms=200
PVT.display_rate_ms=1000
PVT.rinexobs_rate_ms=200
PVT.iono_model=Broadcast
PVT.trop_model=Saastamoinen
PVT.rinex_version=3
PVT.output_path=$folder
PVT.output_enabled=true
PVT.nmea_output_file_enabled=true
PVT.kml_output_enabled=false
PVT.gpx_output_enabled=false
PVT.geojson_output_enabled=false
PVT.rtcm_output_file_enabled=false
PVT.flag_rtcm_server=false
PVT.flag_nmea_tty_port=false
""")


@dataclass(frozen=True, eq=False)
class Received:
    """What a peer made of a recording.

    observations, navigation : its RINEX files, None if it wrote none.
    positions_ecef_m : (n, 3) that it found itself.
    cpu_s : of its whole process.
    sats : that it tracked at any time.
    """

    observations: Path | None
    navigation: Path | None
    positions_ecef_m: np.ndarray
    cpu_s: float
    sats: frozenset[str]


def find() -> bool:
    """Whether it is installed."""
    return shutil.which("gnss-sdr") is not None


def receive(samples: Samples, folder: Path) -> Received:
    """Run it on a recording, with all its files in `folder`.

    Raises
    ------
    RuntimeError : it ended with an error; the message has its last lines.
    ValueError : samples that it is not given here, see `write_as_bytes`.
    """
    folder.mkdir(parents=True, exist_ok=True)
    as_bytes = folder / "samples.ibyte"
    write_as_bytes(samples, as_bytes)
    configuration = folder / "receiver.conf"
    configuration.write_text(
        CONFIGURATION.substitute(rate=f"{samples.rate_hz:.0f}", samples=as_bytes, channels=CHANNELS, folder=folder),
        encoding="ascii",
    )
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    done = subprocess.run(
        ["gnss-sdr", f"--config_file={configuration}", f"--log_dir={folder}"],
        cwd=folder,
        capture_output=True,
        text=True,
        errors="replace",
        check=False,
    )
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    as_bytes.unlink()
    if done.returncode != 0:
        raise RuntimeError(f"gnss-sdr ended with {done.returncode}: {(done.stdout + done.stderr)[-500:]}")
    cpu_s = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    tracked = re.findall(r"Tracking of .* started .* for satellite GPS PRN (\d+)", done.stdout)
    return Received(
        observations=next(iter(sorted(folder.glob("*O"))), None),
        navigation=next(iter(sorted(folder.glob("*N"))), None),
        positions_ecef_m=_positions_ecef_m(folder),
        cpu_s=cpu_s,
        sats=frozenset(f"G{int(prn):02d}" for prn in tracked),
    )


def write_as_bytes(samples: Samples, path: Path) -> None:
    """The same samples as 8-bit I, Q, I, Q. Raises ValueError if the carrier is not in their middle."""
    if samples.if_hz != 0.0 or samples.centre_hz != 1575.42e6:
        raise ValueError(f"{samples.path}: the carrier is not at 0 Hz; this peer is given such samples only")
    block = int(BLOCK_S * samples.rate_hz)
    scale = 100.0 / float(np.abs(samples.read(0, block)).max())
    with open(path, "wb") as file:
        for start in range(0, samples.n_samples, block):
            planes = samples.read(start, min(block, samples.n_samples - start))
            file.write(np.clip(np.rint(planes.T * scale), -127, 127).astype(np.int8).tobytes())


def _positions_ecef_m(folder: Path) -> np.ndarray:
    """From the GGA sentences it wrote; they give a height above the ellipsoid, with no undulation taken off."""
    sentences = "\n".join(path.read_text(encoding="ascii") for path in folder.glob("*.nmea"))
    pattern = r"\$GPGGA,[\d.]+,(\d\d)([\d.]+),([NS]),(\d{3})([\d.]+),([EW]),\d,\d+,[\d.]*,(-?[\d.]+),M"
    places = [
        ecef_from_geodetic(
            np.radians((float(lat) + float(lat_min) / 60.0) * (-1.0 if ns == "S" else 1.0)),
            np.radians((float(lon) + float(lon_min) / 60.0) * (-1.0 if ew == "W" else 1.0)),
            float(height),
        )
        for lat, lat_min, ns, lon, lon_min, ew, height in re.findall(pattern, sentences)
    ]
    return np.array(places).reshape(-1, 3)
