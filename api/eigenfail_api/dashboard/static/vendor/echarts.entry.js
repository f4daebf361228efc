// What of ECharts the dashboard's charts use; deploy/vendor.py builds echarts.min.js of it.
import { BarChart, LineChart, ParallelChart, ScatterChart } from "echarts/charts";
import { GridComponent, LegendPlainComponent, MarkAreaComponent, ParallelComponent, TooltipComponent } from "echarts/components";
import { use } from "echarts/core";
import { CanvasRenderer } from "echarts/renderers";

export { getInstanceByDom, init } from "echarts/core";

use([BarChart, LineChart, ParallelChart, ScatterChart]);
use([GridComponent, LegendPlainComponent, MarkAreaComponent, ParallelComponent, TooltipComponent]);
use([CanvasRenderer]);
