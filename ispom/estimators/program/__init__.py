"""Methods in other languages: a program of its own that is given frames and answers with poses, through a pipe."""

from ispom.estimators.program.config import ProgramConfig
from ispom.estimators.program.method import program_method

__all__ = ["ProgramConfig", "program_method"]
