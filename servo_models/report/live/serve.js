/* Buttons that run commands on the machine that serves this page, and what has come of them.

Answers are only ever set as text, and links lead to names that the server has written. */
"use strict";

globalThis.servoServed = class {
    static COMMANDS = ["check", "identify", "diagnose"];
    static EVERY = 500; // ms between two looks at a job
    static CODES = ["all is well", "it ran, and something is to be looked at"];

    constructor(explorer, make) {
        this.explorer = explorer;
        this.make = make;
        const button = (label, onclick) => make("button", { type: "button", onclick }, label);
        this.buttons = servoServed.COMMANDS.map((name) =>
            button(name[0].toUpperCase() + name.slice(1), () => this.run(name)),
        );
        this.stop = button("Stop", () => this.tried(() => this.ask("stop", "")));
        this.state = make("p", { className: "live-said", role: "status" });
        this.lines = make("pre", {});
        this.links = make("p", {});
        const spaced = [...this.buttons, this.stop].flatMap((it) => [it, " "]);
        explorer.place.append(make("p", {}, ...spaced), this.state, this.lines, this.links);
        this.look();
    }

    async ask(name, body) {
        const answer = await fetch(name, body === undefined ? undefined : { method: "POST", body });
        const told = await answer.json();
        if (!answer.ok) throw new Error(told.error);
        return told;
    }

    /* What fails is told in place of the state. */
    async tried(action) {
        try {
            this.show(await action());
        } catch (error) {
            this.state.textContent =
                error instanceof TypeError ? "the server has ended" : error.message;
        }
    }

    /* On the dropped log, which has another name on the server, else on what the page is of. */
    run(command) {
        const { name, given } = this.explorer,
            file = () => `file = "dropped.csv"\nname = ${JSON.stringify(name)}`;
        return this.tried(async () => {
            if (given.file) await this.ask("log", given.file);
            return this.ask(command, given.file ? given.text.replace(/^file = .*$/m, file) : "");
        });
    }

    look() {
        return this.tried(() => this.ask("job"));
    }

    show({ command, running, stopped, code, lines, files }) {
        const { make } = this;
        for (const it of this.buttons) it.disabled = running;
        this.stop.hidden = !running;
        this.stop.textContent = stopped ? "Stop at once" : "Stop";
        const ended = stopped ? "stopped" : (servoServed.CODES[code] ?? "it could not run");
        if (command) this.state.textContent = `${command}: ${running ? "running" : ended}`;
        this.lines.textContent = lines.join("\n");
        this.links.replaceChildren(
            ...files.flatMap((href) => [
                make("a", { href, target: "_blank", rel: "noopener" }, href),
                " ",
            ]),
        );
        clearTimeout(this.later);
        if (running) this.later = setTimeout(() => this.look(), servoServed.EVERY);
    }
};
