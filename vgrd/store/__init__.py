"""What survives the process: recorded sessions and calibrations."""
