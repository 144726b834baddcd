"""Parts of the equations of motion, redundant motors, base parameters, sensitivities."""
