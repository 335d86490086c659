"""What holds for every test: one thread each, and the slow ones first, so that none is left to wait for."""

import os

# Two workers whose libraries start two threads each wait for one another most of the time.
for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
    os.environ.setdefault(name, "1")


def pytest_collection_modifyitems(items):
    items.sort(key=lambda item: item.get_closest_marker("slow") is None)
