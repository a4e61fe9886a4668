"""Broadcast messages of one receiver: can these satellites have sent them, and be where they say?"""
