"""The files that a rig is kept in, a format a module: ours, OpenCV's, ROS', Kalibr's."""
