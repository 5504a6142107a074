"""The one error of this package that a person can cause."""


class SensorError(ValueError):
    """An instrument cannot be set up as asked. Its text is one line: what, where, how to mend it."""
