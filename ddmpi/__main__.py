"""``python -m ddmpi``: the same as the console script ``ddmpi``.

Before that, the current folder goes from where modules are looked for: Python puts it first, and it may hold anybody's
``h5py.py``. ``python -P -m ddmpi``, as our scripts start it, keeps it out from the very beginning.
"""

if __name__ == "__main__":
    import sys

    if not sys.flags.safe_path:
        del sys.path[0]  # where ddmpi itself lies there: its modules are found by their package

    from ddmpi.system import interrupt

    interrupt.listen()  # before what takes longer to import

    from ddmpi.cli.main import main

    main()
