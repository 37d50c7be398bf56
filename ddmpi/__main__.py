"""``python -m ddmpi``: the same as the console script ``ddmpi``."""

from ddmpi.cli import main

if __name__ == "__main__":
    main()
