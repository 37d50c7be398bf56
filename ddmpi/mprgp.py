"""Our TAO type under its old name, which stands in users' options: ``-tao_python_type ddmpi.mprgp.MPRGP``."""

from ddmpi.qp.mprgp import MPRGP

__all__ = ["MPRGP"]
