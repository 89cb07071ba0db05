# SPDX-License-Identifier: GPL-3.0-or-later
"""Runs the vtex program: where it is, how far it has got, how it is stopped."""

import os
import queue
import shutil
import signal
import subprocess
import threading

import bpy


def path():
    """The program, or an error that says what to do."""
    addon = bpy.context.preferences.addons.get(__package__)
    chosen = bpy.path.abspath(addon.preferences.program) if addon and addon.preferences.program else ""
    found = chosen or os.environ.get("VTEX", "") or shutil.which("vtex")
    if not found or not os.path.isfile(found):
        raise RuntimeError("the vtex program was not found: put it on PATH, or name it in this add-on's preferences")
    return found


class Running:
    """A command under way. `poll` gives new lines; `result` is None while it runs, then "" or the error's line."""

    def __init__(self, arguments, cwd=None):
        new_group = {"creationflags": subprocess.CREATE_NEW_PROCESS_GROUP} if os.name == "nt" else {"start_new_session": True}
        self.process = subprocess.Popen([path(), *arguments], cwd=cwd, text=True, errors="replace", stdin=subprocess.DEVNULL,
                                        stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, **new_group)
        self.lines = queue.Queue()
        self.last = ""
        self.reader = threading.Thread(target=self.read, daemon=True)
        self.reader.start()

    def read(self):
        for line in self.process.stderr:
            self.lines.put(line.rstrip())

    def poll(self):
        out = []
        while not self.lines.empty():
            line = self.lines.get()
            if line.startswith("error:"):
                self.last = line.removeprefix("error:").strip()
            out.append(line)
        return out

    @property
    def result(self):
        code = self.process.poll()
        if code is None:
            return None
        self.reader.join(timeout=5)
        self.poll()
        return "" if code == 0 else self.last or f"vtex ended with {code}"

    def cancel(self):
        """vtex leaves nothing half-written behind when it is interrupted."""
        if self.process.poll() is None:
            # Not SIGINT, which is ignored by all that a shell's background job starts.
            self.process.send_signal(signal.CTRL_BREAK_EVENT if os.name == "nt" else signal.SIGTERM)
        self.process.wait()


def run(arguments, cwd=None):
    """Run to the end. Gives the lines it wrote; raises the error's line."""
    running = Running(arguments, cwd)
    running.process.wait()
    running.reader.join()
    lines = running.poll()
    if running.result:
        raise RuntimeError(running.result)
    return lines


class Waiting:
    """Mix-in of an operator that runs a command: in the foreground without windows, else with progress, and Escape cancels."""

    def begin(self, context, arguments):
        self.running = Running(arguments)
        if bpy.app.background:
            self.running.process.wait()
            return self.end(context)
        self.timer = context.window_manager.event_timer_add(0.2, window=context.window)
        context.window_manager.modal_handler_add(self)
        return {"RUNNING_MODAL"}

    def modal(self, context, event):
        if event.type == "ESC":
            self.running.cancel()
            self.leave(context)
            self.report({"INFO"}, "cancelled")
            return {"CANCELLED"}
        if event.type != "TIMER":
            return {"PASS_THROUGH"}
        for line in self.running.poll():
            context.workspace.status_text_set(f"vtex: {line}   (Esc cancels)")
        if self.running.result is None:
            return {"PASS_THROUGH"}
        self.leave(context)
        return self.end(context)

    def leave(self, context):
        context.window_manager.event_timer_remove(self.timer)
        context.workspace.status_text_set(None)

    def end(self, context):
        if self.running.result:
            self.report({"ERROR"}, self.running.result)
            return {"CANCELLED"}
        return self.done(context)
