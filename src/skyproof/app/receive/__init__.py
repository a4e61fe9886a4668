"""Recordings to observations: open, track everything, write what was measured, without judging it."""

from skyproof.app.receive.run import ReceiveResult, receive, write_document_json

__all__ = ["ReceiveResult", "receive", "write_document_json"]
