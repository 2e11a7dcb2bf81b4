"""The recorded torque or command drives the model: how far does its motion come from the recorded one?"""
