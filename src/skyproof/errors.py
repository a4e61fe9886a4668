"""What can go wrong, in the user's words.

    SkyproofError           the root: the command line catches it once and prints one line
    ├── InputError          a file or stream that cannot be read as what it should be
    ├── OutputError         a place that cannot be written
    ├── SettingsError       an option, platform file or setting that makes no sense
    ├── ScenarioError       a scene that cannot be simulated
    └── NotEnoughData       readable, but too little or too poor to work on

Each message says what came, where (file, byte, line, key), what was expected and what to do about it.
"""


class SkyproofError(Exception):
    """Root of the errors that a user can mend; anything else that is raised is our mistake."""


class InputError(SkyproofError):
    """A file or stream cannot be read as what it should be."""


class OutputError(SkyproofError):
    """A file or folder cannot be written."""


class SettingsError(SkyproofError):
    """An option, platform file or setting makes no sense."""


class ScenarioError(SkyproofError):
    """A scene cannot be simulated."""


class NotEnoughData(SkyproofError):
    """The input is readable, but too little or too poor to work on."""
