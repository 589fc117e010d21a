"""Stdout while C code prints: that goes nowhere, what Python prints stays."""

import subprocess
import sys

PRINTS = """
import ctypes
from linear_ik.quiet import silence
puts = ctypes.CDLL(None).puts
puts(b"before")
with silence():
    puts(b"dropped")
    print("kept")
puts(b"after")
"""


def test_silence_drops_what_c_prints_and_keeps_what_python_does():
    # To a pipe, where C buffers.
    out = subprocess.run([sys.executable, "-c", PRINTS], capture_output=True, text=True, check=True).stdout
    assert out.split() == ["before", "kept", "after"]
