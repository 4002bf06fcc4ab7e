"""Where pictures come from: cameras and recordings, behind one protocol. No bus, no poses."""
