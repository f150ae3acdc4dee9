import pytest

from backsight.engine import _cache


@pytest.fixture(autouse=True, scope="session")
def cache_of_the_tests(tmp_path_factory):
    """Compile into a folder of the tests, with a key of their own, not into that of the user."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("BACKSIGHT_CACHE", str(tmp_path_factory.mktemp("cache")))
        patch.setenv("XDG_STATE_HOME", str(tmp_path_factory.mktemp("state")))
        _cache._key.cache_clear()  # tests of other folders may have read that of the user
        yield
        _cache._key.cache_clear()
