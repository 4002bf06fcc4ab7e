"""Settings of the whole suite."""

from __future__ import annotations

from hypothesis import settings

# A busy machine is no failure: how long an example takes says more of its neighbours than of the law.
settings.register_profile("muro", deadline=None)
settings.load_profile("muro")
