"""Where the robot has been: submaps, constraints between them, loops closed, and the poses that fit all of that."""
