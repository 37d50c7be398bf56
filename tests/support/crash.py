"""A function that ends its process, as libhdf5 does on some damaged files; for tests of work in another process."""

import signal


def crash(*_: object) -> None:
    signal.raise_signal(signal.SIGSEGV)
