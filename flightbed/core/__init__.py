"""Values and tools that everything else uses: units, errors, signals, the actuator, the atmosphere, files, compiled functions."""
