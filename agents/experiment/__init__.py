"""An experiment as data: arms, settings, environments, the run folder, the command line."""
