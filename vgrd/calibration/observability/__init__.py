"""What a set of poses or residuals can tell, and which of them do not belong.

Imports geometry only.
"""
