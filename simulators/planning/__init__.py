"""What a scene will come to, found without devices: its plan, its bounds, its steady state and its waveforms."""
