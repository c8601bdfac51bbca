"""Random calls, legal and illegal: refused with a sentence, or answered within range."""

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from benchmarks.fuzz import CALLS, try_call


@pytest.mark.parametrize("name", CALLS)
@settings(max_examples=60)
@given(seed=st.integers(0, 2**31))
def test_a_call_is_refused_with_a_sentence_or_answered_in_range(name, seed):
    try_call(name, seed)
