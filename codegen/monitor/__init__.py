"""The numbers of the monitor on the board: how its alarms are set so that false ones are as rare as stated."""
