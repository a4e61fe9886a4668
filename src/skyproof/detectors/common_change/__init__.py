"""Find changes common to all satellites of one antenna that neither the sky nor a receiver makes."""
