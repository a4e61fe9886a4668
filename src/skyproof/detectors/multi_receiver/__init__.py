"""Compare several receivers: which signals come from one transmit antenna, which from the sky."""
