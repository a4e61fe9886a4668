"""One folder a method: pure statistics functions first, then one thin detector object that sees records only."""
