"""The command `simvehicle`."""
