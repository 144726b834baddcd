"""Cyclic garbage in processes of ocptip's own: in one of its own, for it changes the whole process."""

import subprocess
import sys

OWN = """
import gc
from ocptip.numerics.few_cycles import loaded
while_loading, frozen = gc.get_threshold()[0], gc.get_freeze_count()
loaded()
print(while_loading > gc.get_threshold()[0] > 0, gc.isenabled(), frozen, gc.get_freeze_count() > 1000)
"""


def test_what_is_loaded_is_not_looked_at_again():
    found = subprocess.run([sys.executable, "-c", OWN], capture_output=True, text=True, check=True)
    assert found.stdout.split() == ["True", "True", "0", "True"]
