"""What is in a recording, and is it usable; and what a recording may be that nothing describes."""

from skyproof.app.inspect.run import (
    Inspection,
    NotUnderstood,
    Satellite,
    document_json,
    inspect,
    inspect_recording,
    inspect_samples,
    oscillator_remarks,
    write_pictures,
)

__all__ = [
    "Inspection",
    "NotUnderstood",
    "Satellite",
    "document_json",
    "inspect",
    "inspect_recording",
    "inspect_samples",
    "oscillator_remarks",
    "write_pictures",
]
