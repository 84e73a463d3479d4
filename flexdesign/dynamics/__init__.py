"""The signal chain in time: command, driver, hysteresis, actuator, forces, modes, sensor, and the loop around them."""
