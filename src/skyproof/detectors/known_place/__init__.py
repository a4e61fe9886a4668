"""The few satellites that are left: do their codes fit the place where the receiver stands?"""
