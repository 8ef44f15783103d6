"""The log of a run: an MCAP file with ROS 2 messages, the same from twin, emulated lamp and physical lamp."""
