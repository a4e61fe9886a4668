"""What changes alike on all satellites of one antenna, as neither the sky nor a receiver does it."""
