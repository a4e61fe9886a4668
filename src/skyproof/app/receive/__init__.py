"""Recordings to observations: open, track everything, write what was measured, without judging it."""

from skyproof.app.receive.run import ReceiveResult, document_json, receive

__all__ = ["ReceiveResult", "document_json", "receive"]
