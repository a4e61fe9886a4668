"""The receiver and `protect` behind correlators that are drawn at random: what every tap holds, without samples.

Loops, lock control, telemetry, measurements, detectors, prediction and decision are the package's own, unchanged. In
place of samples and of the kernels that correlate them stand signals and reflections of a simulated scene: over each
code period a wave of amplitude A adds to a tap d chips ahead

    A R(lag - d) sin(pi f T)/(pi f T) exp(2 pi i phase)

with lag, phase and frequency f against the replica as the loops steer it, R the correlation of the code behind the
front end with the receiver's low-pass replica. Amplitudes, the quantiser's loss and the noise (the other satellites'
signals in it) are those of `skyproof.simulator.correlate`. Noise is Gaussian and correlates between taps as replicas
do. Correlation grids are made alike with a replica that the grid's band cuts off.

A search finds what stands above `FIND_DBHZ` a chip or more from all that is followed. Left out: noise that channels on
one satellite, or a channel and its grid, have in common; what sampled chips fold back; cross-correlation but as noise;
the turn of a data bit within a code period of a signal that is late by a chip.
"""

from skyproof.studies.correlator_model.receiver import ModelReceiver
from skyproof.studies.correlator_model.session import protect_scene, receive_antenna, track_scene
from skyproof.studies.correlator_model.waves import STEP_S, Waves, compute_waves

__all__ = ["STEP_S", "ModelReceiver", "Waves", "compute_waves", "protect_scene", "receive_antenna", "track_scene"]
