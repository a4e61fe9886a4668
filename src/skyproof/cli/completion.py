"""`skyproof --install-completion`: commands and options completed with Tab."""

from pathlib import Path
from typing import Annotated, Literal

from cyclopts import Parameter
from cyclopts.completion.detect import ShellDetectionError

from skyproof.cli import app
from skyproof.cli.screen import print_path
from skyproof.errors import OutputError, SettingsError

__all__ = ["install_completion"]


def install_completion(
    *,
    shell: Annotated[
        Literal["bash", "zsh", "fish"] | None, Parameter(help="Without it the shell that this was called from.")
    ] = None,
    output: Annotated[
        Path | None, Parameter(help="File for the script, in place of the shell's own folder and start-up file.")
    ] = None,
) -> int:
    """Install completion of commands, options and files with Tab.

    It writes a script, and a line into the start-up file.

    bash loads it from ~/.bashrc, zsh from ~/.zshrc, fish from ~/.config/fish/completions; it works in a new shell.
    """
    try:
        path = app.install_completion(shell=shell, output=output, add_to_startup=output is None)
    except ShellDetectionError as error:
        raise SettingsError("the environment does not say which shell this is; name it, as in --shell bash") from error
    except OSError as error:
        raise OutputError(
            f"{error.filename or output}: cannot be written ({error.strerror or error}); name another file with "
            "--output"
        ) from error
    print_path("completion:", path)
    return 0
