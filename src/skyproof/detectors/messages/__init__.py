"""Test one receiver's broadcast messages: can these satellites have sent them, and be where they say?"""
