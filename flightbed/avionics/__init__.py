"""Models that the flight computer holds before take-off: short period, schedule, roll and yaw.

Their derivation from an aircraft is in ``models/``; laws and estimators that use them are in ``control/`` and ``estimation/``.
"""
