"""Sensors with time stamps, rates and delays of their own, put into rows in time order, batch by batch."""
