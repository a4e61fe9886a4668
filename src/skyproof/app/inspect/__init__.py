"""What is in a recording, and is it usable; and what a recording may be that nothing describes."""

from skyproof.app.inspect.advice import oscillator_remarks
from skyproof.app.inspect.inspection import Inspection, Satellite, document_json
from skyproof.app.inspect.log import LogInspection
from skyproof.app.inspect.run import inspect
from skyproof.app.inspect.signal_pictures import write_pictures
from skyproof.app.inspect.signals import inspect_recording, inspect_samples
from skyproof.app.inspect.undescribed import NotUnderstood, sidecar_lines

__all__ = [
    "Inspection",
    "LogInspection",
    "NotUnderstood",
    "Satellite",
    "document_json",
    "inspect",
    "inspect_recording",
    "inspect_samples",
    "oscillator_remarks",
    "sidecar_lines",
    "write_pictures",
]
