"""Our TAO type under the name in users' options: ``-tao_python_type ddmpi.mprgp.MPRGP``."""

from ddmpi.published.mprgp import MPRGP

__all__ = ["MPRGP"]
