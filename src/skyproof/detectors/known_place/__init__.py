"""Test if the codes of the few remaining satellites fit the place where the receiver stands."""
