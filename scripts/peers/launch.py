"""Runs a command; writes its seconds, the peak memory (MiB) of its largest process and its exit code to a file.

    python launch.py FILE COMMAND …

A small process of its own, because Linux counts the memory of a process that starts another one as that one's.
"""

import json
import os
import subprocess
import sys
import time

start = time.perf_counter()
child = subprocess.Popen(sys.argv[2:], stdin=subprocess.DEVNULL)
_, status, usage = os.wait4(child.pid, 0)
found = {"seconds": time.perf_counter() - start, "memory": usage.ru_maxrss / 1024,
         "code": os.waitstatus_to_exitcode(status)}
with open(sys.argv[1], "w", encoding="utf-8") as file:
    json.dump(found, file)
