"""Settings of all tests: hypothesis draws the same examples on every machine and every run."""

import gc

import hypothesis

hypothesis.settings.register_profile(
    "repeatable", derandomize=True, database=None, deadline=None, max_examples=25
)
hypothesis.settings.load_profile("repeatable")

# Thousands of tests are found and none is thrown away: looking for garbage meanwhile takes a third
# of the time until the first one begins, in each process.
gc.disable()


def pytest_collection_finish(session):
    gc.enable()
    gc.freeze()
