"""The world: simulated vehicles, instruments, wind, plumes, trials and whole simulated surveys."""
