"""What is wrong with a command line: what came, what was expected, what to do."""

import re

from cyclopts import CycloptsError, MissingArgumentError, RepeatArgumentError, UnusedCliTokensError
from cyclopts.exceptions import CoercionError

__all__ = ["describe_usage"]

KINDS = {"float": "a number", "int": "a whole number", "bool": "nothing: it is a switch"}


def describe_usage(error: CycloptsError) -> str:
    """Describe a usage error on one line, with the command that gives help."""
    command = " ".join(("skyproof", *(error.command_chain or ())))
    return f"{_words(error)} For help: {command} --help"


def _words(error: CycloptsError) -> str:
    words, argument = str(error), error.argument
    match error:
        case MissingArgumentError() if argument is not None:
            return f"{argument.names[0]} is missing, or lacks a value. Expected: {argument.parameter.help}"
        case CoercionError() if found := re.search(r'for (\S+): unable to convert "(.*)" into (\w+)\.', words):
            return f'{found[1]} = "{found[2]}", expected {KINDS.get(found[3], found[3])}.'
        case RepeatArgumentError():
            return f"{error.token.keyword} is given more than once; give it once."
        case UnusedCliTokensError():
            return f"Not understood: {' '.join(error.unused_tokens or ())}; leave it out."
    return words
