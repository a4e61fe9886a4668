"""What is in a recording, and is it usable; and what a recording may be that nothing describes."""

from skyproof.app.inspect.advice import remark_on_oscillator
from skyproof.app.inspect.inspection import Inspection, Satellite, write_document_json
from skyproof.app.inspect.log import LogInspection
from skyproof.app.inspect.run import inspect
from skyproof.app.inspect.signal_pictures import write_pictures
from skyproof.app.inspect.signals import inspect_recording, inspect_samples
from skyproof.app.inspect.undescribed import NotUnderstood, write_sidecar_lines

__all__ = [
    "Inspection",
    "LogInspection",
    "NotUnderstood",
    "Satellite",
    "inspect",
    "inspect_recording",
    "inspect_samples",
    "remark_on_oscillator",
    "write_document_json",
    "write_pictures",
    "write_sidecar_lines",
]
