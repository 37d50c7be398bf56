"""The ways a run can fail, each with the exit code that scripts see."""


class DdmpiError(Exception):
    """Base of all errors whose message is meant for the user and needs no traceback.

    ``agreed`` says that all ranks raise this error, so that the run can end in an orderly way; the message
    begins with its ``kind``.
    """

    exit_code = 1
    agreed = False
    kind = "error"


class InputError(DdmpiError):
    """The scene, a mesh or the command line is not acceptable; raised before any work is done."""

    exit_code = 2


class NotConvergedError(DdmpiError):
    """The outer iteration stopped without a certified answer."""

    exit_code = 3


class SolverError(DdmpiError):
    """A linear or quadratic subproblem could not be solved to the precision it needs."""

    exit_code = 4


class OutputError(DdmpiError):
    """Results could not be written."""

    exit_code = 5


class TakenError(OutputError):
    """A file stands where a result is to go."""


class InterruptionError(DdmpiError):
    """A signal asked the run to end; where it is `kept`, what it had computed is in a checkpoint.

    Parameters
    ----------
    signal : its name
    """

    exit_code = 6
    kept = False

    def __init__(self, signal: str) -> None:
        super().__init__("before the first iteration; there was nothing to save")
        self.kind = f"interrupted by {signal}"

    def __reduce__(self) -> tuple:
        return type(self), ("",), self.__dict__ | {"args": self.args}
