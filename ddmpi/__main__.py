"""``python -m ddmpi``: the same as the console script ``ddmpi``."""

if __name__ == "__main__":
    from ddmpi.system import interrupt

    interrupt.listen()  # before what takes longer to import

    from ddmpi.cli.main import main

    main()
