"""Plan, steady state, waveforms and load sets of a scene, computed without devices."""
