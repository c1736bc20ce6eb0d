"""From samples to amplitudes: fitting sines in noise, hum and drift, with uncertainty."""
