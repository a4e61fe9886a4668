"""Codes of two bands of one satellite: do they differ by no more than the ionosphere and the receiver can make?"""
