"""What moves a lamp's joints and what its encoders read: the servo's laws, THE motor step, gears."""
