"""What holds for all tests."""

from hypothesis import settings

# A busy machine makes any example slow now and then; no test is about time.
settings.register_profile("linear_ik", deadline=None)
settings.load_profile("linear_ik")
