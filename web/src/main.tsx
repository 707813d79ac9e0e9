import { render } from "preact";

render(<h1>advee</h1>, document.body);
