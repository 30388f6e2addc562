"""The samples of each sensor are interpreted before any graph: intervals of the IMU, counts of the tach and rests."""
