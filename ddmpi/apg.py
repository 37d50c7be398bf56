"""Our TAO type for discs under the name in users' options: ``-tao_python_type ddmpi.apg.APG``."""

from ddmpi.published.apg import APG

__all__ = ["APG"]
