"""Receivers' own logs: bytes of UBX, SBF, RTCM 3, NMEA and text logs to records. One module a protocol."""
